namespace Terraport
{
    /// <summary>Where a transport stands; it only ever moves on.</summary>
    public enum TransportState
    {
        /// <summary>Made, not opened.</summary>
        Idle,

        /// <summary>On its way: TCP, TLS, WebSocket handshake.</summary>
        Connecting,

        /// <summary>Messages flow.</summary>
        Open,

        /// <summary>Over, or never came about. What was received before can still be taken.</summary>
        Closed,
    }
}
