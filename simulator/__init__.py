"""The other end of the bus: a two-mass arm with gaps and friction, CiA 402 drives, a hand."""
