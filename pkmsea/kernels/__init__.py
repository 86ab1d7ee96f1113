"""CasADi Functions at many instants at once: programs of the vector machine, and pipelines of them and linear systems.

Arrays hold one row per number and one column per instant, (rows, k), so that what happens at all instants lies side by
side in memory. No compiler is needed: the bridge holds the machine, built once at installation for several instruction
sets, and picks the widest that this processor has.
"""

from pkmsea.kernels.batch import Batch
from pkmsea.kernels.function import named_function
from pkmsea.kernels.program import Factors, Pipeline, program

__all__ = ["Batch", "Factors", "Pipeline", "named_function", "program"]
