"""The stability map: stiff and extreme scenes, each carried out by the program's own parts in a process of its own."""
