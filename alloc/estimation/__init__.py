"""What is learnt about the train from its runs: brake force per car, wheel damage."""
