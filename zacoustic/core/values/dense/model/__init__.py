"""The prediction of the next sample of a type, field by field, and how it is learnt."""
