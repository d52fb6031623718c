"""Pictures, films and HTML pages of highway scenes, made without a screen."""
