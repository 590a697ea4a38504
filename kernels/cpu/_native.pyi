def instruction_sets() -> list[str]:
    """Instruction sets this machine can run, the best first; "scalar" is the last."""
