"""The leaderboard of slip control: figures and page."""
