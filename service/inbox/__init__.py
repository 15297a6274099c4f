"""An inbox: a folder or store whose flight records are sent once each, whatever happens in between."""
