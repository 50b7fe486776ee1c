"""Sanders: a full-scale trial, and where sand stops a train soonest."""
