"""Steps of `contactd identify`, in a process beside the daemon or on recorded logs."""
