"""Paper B's finger from its requirements: linkage, mirrors, grasp."""
