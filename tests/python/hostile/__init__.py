"""Parts of `hostile.py`: attacks on real services, faults of the machine, honest clients, and the counts."""
