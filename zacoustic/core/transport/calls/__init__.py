"""Services: a request crosses, a response or an error comes back."""
