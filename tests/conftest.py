"""Before anything loads numpy: as in the program, matrices get one thread."""
from console.threads import few_for_matrices

few_for_matrices()
