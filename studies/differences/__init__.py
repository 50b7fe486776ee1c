"""Where greedy, exact level and QP differ."""
