"""Bridge to ROS 2 over Zenoh, `contactd-zenoh`: a separate process, client of the view socket."""
