"""Boot-up by SDO, before NMT operational. The only package that imports canopen."""
