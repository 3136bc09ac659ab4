using System;

namespace Terraport.Wire
{
    /// <summary>
    /// What the other side sent is not allowed. <c>malformed</c>: no message and no frame. <c>too_large</c>: beyond the limit
    /// of its direction. <c>invalid_field</c>: a known message with a field that is missing, mistyped or out of range.
    /// </summary>
    public sealed class DecodeException : Exception
    {
        // Messages that are refused alone: they changed nothing, so the session goes on.
        private static readonly string[] NotFatal = { "aim", "land", "pick", "join", "gather" };

        internal DecodeException(string code, string text) : base(text) { Code = code; }

        internal DecodeException(string code, string text, int offset) : base(text + " (at byte " + offset + ")") { Code = code; }

        internal DecodeException(string messageType, string field, string text, uint? generation, uint? request)
            : base(messageType + "." + field + ": " + text)
        {
            Code = "invalid_field";
            MessageType = messageType;
            Field = field;
            Generation = generation;
            Request = request;
        }

        /// <summary>Error code of the wire protocol.</summary>
        public string Code { get; }

        /// <summary>Type of the refused message, where one is known.</summary>
        public string MessageType { get; }

        /// <summary>Path of the refused field, for example <c>budgets.max_bytes</c>; null where none is known.</summary>
        public string Field { get; }

        /// <summary>Generation of the refused message, where it has one.</summary>
        public uint? Generation { get; }

        /// <summary>Request of the refused message, where it has one.</summary>
        public uint? Request { get; }

        /// <summary>False for messages that change nothing by being refused; else the connection cannot go on.</summary>
        public bool IsFatal => MessageType == null || Array.IndexOf(NotFatal, MessageType) < 0;
    }
}
