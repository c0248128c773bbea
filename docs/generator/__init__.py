"""Builds the documentation: pages by people, pages made from the code, pictures, results."""
