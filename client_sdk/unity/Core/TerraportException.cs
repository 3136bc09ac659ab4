using System;

namespace Terraport
{
    /// <summary>Something that terraport cannot do, with a code that programs can tell apart.</summary>
    public class TerraportException : Exception
    {
        /// <summary>An error with a code for programs and a text for people: what was received, what was expected, what can be done.</summary>
        public TerraportException(string code, string message) : this(code, message, null, null) {}

        /// <summary>The same with a WebSocket close code or HTTP status, and what caused it; either may be null.</summary>
        public TerraportException(string code, string message, int? closeCode, Exception inner) : base(message, inner)
        {
            Code = code;
            CloseCode = closeCode;
        }

        /// <summary>
        /// Error code of the protocol, or one of the client's: "damaged", "unsupported_version", "invalid_url",
        /// "unreachable", ...
        /// </summary>
        public string Code { get; private set; }

        /// <summary>WebSocket close code or HTTP status, where there is one.</summary>
        public int? CloseCode { get; private set; }
    }
}
