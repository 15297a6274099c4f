"""An installation as a whole: backup, restore, check; a pump's bundle and its replay; an operator's export taken in."""
