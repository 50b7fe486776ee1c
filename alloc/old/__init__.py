"""The train, what runs on board, and the rules that share adhesion among its cars."""
