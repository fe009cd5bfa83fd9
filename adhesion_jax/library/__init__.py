"""The package from Python: what the commands do, as functions of data frames.

They compute in double precision and on the CPU, whatever jax prefers in the program around them,
and leave its settings, its flags and its environment as they are. What they are given and cannot
use they refuse by an InputError of one sentence.
"""
