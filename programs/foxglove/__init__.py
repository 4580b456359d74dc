"""`contactd-foxglove`: States of a running arm to Foxglove, live."""
