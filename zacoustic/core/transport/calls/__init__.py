"""Services: requests cross the channel, responses or errors come back."""
