"""The CAN side: bus, CANopen boot-up, CiA 402 states, PDO codec, and the arm as arrays."""
