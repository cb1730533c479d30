"""The virtual machine: the plant of `control.simulation` behind the same bytes that the real
devices speak."""
