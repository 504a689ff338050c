"""Whatever fails underneath, a result is the old one or the new one, whole, and a line says what happened."""
