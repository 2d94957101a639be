"""Films of takes: drawn frame by frame without interface, written as MP4, numbered PNG files, WebP or GIF."""
