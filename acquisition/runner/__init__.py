"""The session loop and all that it needs beside the stages: steps, shots, safety, compute process, planning for people.

`runner.Runner` is the face; `loop` does one step after another, `step_executor` and `shots` do them.
"""
