"""The session loop and what it needs beside the stages: steps, shots, safety monitor, compute process, planning.

`runner.Runner` is the facade; `loop` repeats steps, `step_executor` and `shots` carry them out.
"""
