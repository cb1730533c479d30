"""The loop and the machine model closed on an injected clock: tractor, canopy, plant, and what
came to lie where."""
