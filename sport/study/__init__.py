"""A user study that anyone can run (Sec. IV-D of the paper): the page with its films, and the report on its answers."""
