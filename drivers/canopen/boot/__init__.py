"""Boot-up by SDO, before NMT operational. The only place that imports canopen."""
