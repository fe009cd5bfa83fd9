"""Tables and figures of the studies that judge the methods."""
