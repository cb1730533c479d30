"""What the machine model gets wrong on measured data, why, and what putting it right gains."""
