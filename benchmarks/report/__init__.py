"""The figures and tables of the 2014 report again, and the sheet of all scenes."""
