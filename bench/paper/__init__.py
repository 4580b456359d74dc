"""The paper's figures, re-made on the simulated arm: `python -m bench.paper`."""
