using System;

namespace Terraport.Json
{
    /// <summary>Bytes that are not the one JSON value that was expected.</summary>
    public sealed class JsonException : Exception
    {
        /// <summary>An error whose text ends with the byte offset.</summary>
        /// <param name="message">What was found and what was expected.</param>
        /// <param name="offset">Byte at which reading stopped.</param>
        public JsonException(string message, int offset) : base(message + " (at byte " + offset + ")")
        {
            Reason = message;
            Offset = offset;
        }

        /// <summary>What was found and what was expected, without the byte.</summary>
        internal string Reason { get; }

        /// <summary>Byte at which reading stopped, counted from the first one given.</summary>
        public int Offset { get; }
    }
}
