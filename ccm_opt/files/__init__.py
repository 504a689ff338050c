"""Files in and out: problem files, drawings, the output folder, pictures and the page."""
