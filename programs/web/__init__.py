"""`contactd-web`: server of the web page, a separate process and client of the view socket."""
