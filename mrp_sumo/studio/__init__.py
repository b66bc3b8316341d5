"""The workbench in the browser: a face of the commands, over the files of one folder."""
