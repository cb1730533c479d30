"""Which days does the simulated world have, and what must hold on each of them?"""
