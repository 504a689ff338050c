"""What an arm in space has to keep away from: bodies in a room, and all their surfaces as triangles."""
