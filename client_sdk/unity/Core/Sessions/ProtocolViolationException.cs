using System;

namespace Terraport.Sessions
{
    /// <summary>The server broke the wire protocol; the connection cannot be used any further.</summary>
    public sealed class ProtocolViolationException : Exception
    {
        internal ProtocolViolationException(string message) : base(message) {}

        internal ProtocolViolationException(string message, Exception inner) : base(message, inner) {}
    }
}
