namespace Terraport
{
    /// <summary>Where the connection stands.</summary>
    public enum LinkPhase
    {
        /// <summary>Under way.</summary>
        Connecting,

        /// <summary>The scene is open.</summary>
        Open,

        /// <summary>Lost; another attempt comes by itself.</summary>
        Waiting,

        /// <summary>For good, until a reconnect is asked for.</summary>
        Closed,
    }
}
