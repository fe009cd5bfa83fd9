"""Whether a change made any identifier less accurate or slower: measured, then held against a file.

Accuracy is compared as two independent samples of runs, speed as a ratio to a NumPy peer.
"""
