"""Time lines and coordination diagrams of many arms: values, figures, and the panel of the page."""
