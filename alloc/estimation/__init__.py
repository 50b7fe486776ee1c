"""What is learnt about the train from its runs: increments, running resistance, brake force per car."""
