"""The WebSocket: connections, sessions run over them, and whose payload goes next."""
