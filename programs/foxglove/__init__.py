"""`contactd-foxglove`: live States of a running arm for Foxglove."""
