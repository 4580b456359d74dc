"""CANopen drives (CiA 402): set-up by SDO, samples and setpoints by PDO, stops, monitoring."""
