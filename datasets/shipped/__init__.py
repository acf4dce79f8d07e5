"""Real data that come with the package; ``dancers.txt`` names their source and terms."""
