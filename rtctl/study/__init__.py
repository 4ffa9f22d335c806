"""Studies that anyone can repeat: ``rtctl study``. They report what they find."""
