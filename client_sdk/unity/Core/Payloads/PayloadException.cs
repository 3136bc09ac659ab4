using System;
using System.Globalization;

namespace Terraport
{
    /// <summary>Bytes that are not what the scene format says; code "damaged".</summary>
    public sealed class PayloadException : TerraportException
    {
        /// <summary>An error without an offset: what was received and what was expected.</summary>
        public PayloadException(string message) : base("damaged", message) { Offset = -1; }

        /// <summary>An error with the byte of the payload at which it was noticed.</summary>
        public PayloadException(string message, long offset)
            : base("damaged", message + " (payload offset " + offset.ToString(CultureInfo.InvariantCulture) + ")")
        {
            Offset = offset;
        }

        /// <summary>Byte of the payload at which it was noticed; -1 where none is known.</summary>
        public long Offset { get; private set; }
    }
}
