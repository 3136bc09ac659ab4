namespace Terraport.Wire
{
    /// <summary>What a client does after a connection was closed (section 11).</summary>
    public enum AfterClose
    {
        /// <summary>Nothing: it said goodbye.</summary>
        Done,

        /// <summary>Connect again.</summary>
        Again,

        /// <summary>Ask for another token.</summary>
        Token,

        /// <summary>Stop: it would be refused again.</summary>
        Stop,
    }
}
