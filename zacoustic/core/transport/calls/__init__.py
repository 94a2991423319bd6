"""Services: a request crosses, and a response or an error comes back: an exchange."""
