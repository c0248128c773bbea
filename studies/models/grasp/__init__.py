"""The finger closing on objects: contacts, equilibrium, pinch."""
