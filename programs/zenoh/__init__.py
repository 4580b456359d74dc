"""Door to ROS 2 over Zenoh, `contactd-zenoh`: a process beside the daemon, at the view socket."""
