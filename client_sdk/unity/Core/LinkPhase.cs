namespace Terraport
{
    /// <summary>Where the connection stands.</summary>
    public enum LinkPhase
    {
        /// <summary>An attempt is under way: TCP, TLS, WebSocket, welcome.</summary>
        Connecting,

        /// <summary>The server has said welcome: landings are answered.</summary>
        Open,

        /// <summary>Lost; another attempt comes by itself.</summary>
        Waiting,

        /// <summary>Over, and not tried again until Reconnect is called.</summary>
        Closed,
    }
}
