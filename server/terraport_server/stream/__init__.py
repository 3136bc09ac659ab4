"""WebSocket: connections, senders of sessions, and the order of sending."""
