"""`contactd-web`: the page beside the arm. A process of its own, a client at the view socket."""
