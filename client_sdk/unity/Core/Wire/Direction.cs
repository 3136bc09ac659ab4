namespace Terraport.Wire
{
    /// <summary>Who sends a message.</summary>
    public enum Direction
    {
        /// <summary>Sent by a client.</summary>
        ClientToServer,

        /// <summary>Sent by a server.</summary>
        ServerToClient,
    }
}
