"""What connects this project to other tools: reinforcement learning, co-simulation, benchmarks of solvers, MATLAB."""
