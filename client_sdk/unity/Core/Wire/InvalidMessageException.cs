using System;

namespace Terraport.Wire
{
    /// <summary>Our own side tried to send what the protocol does not allow.</summary>
    public sealed class InvalidMessageException : ArgumentException
    {
        internal InvalidMessageException(string messageType, string field, string text) : base(messageType + "." + field + ": " + text)
        {
            MessageType = messageType;
            Field = field;
        }

        /// <summary>Type of the message that was not sent.</summary>
        public string MessageType { get; }

        /// <summary>Path of the field that the protocol does not allow.</summary>
        public string Field { get; }
    }
}
