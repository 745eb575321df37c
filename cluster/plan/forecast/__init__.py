"""What a render's rays will do, as far as a few of them tell before anything is handed out."""
