namespace Terraport.Wire
{
    /// <summary>Who sends a message.</summary>
    public enum Direction
    {
        /// <summary>The client.</summary>
        ClientToServer,

        /// <summary>The server.</summary>
        ServerToClient,
    }
}
