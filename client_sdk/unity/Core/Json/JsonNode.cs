namespace Terraport.Json
{
    /// <summary>One value of a <see cref="JsonTape"/>.</summary>
    internal struct JsonNode
    {
        /// <summary>Decides what the other fields mean.</summary>
        internal JsonNodeKind Kind;

        /// <summary>Of a container: a comma stands before what comes next.</summary>
        internal bool IsExpecting;

        /// <summary>Byte of a scalar's first character; of a text without its quotation mark.</summary>
        internal int Start;

        /// <summary>Bytes of a scalar, quotation marks left out.</summary>
        internal int Length;

        /// <summary>Entries of a container; escapes of a text.</summary>
        internal int Count;

        /// <summary>The node after this one and everything in it.</summary>
        internal int Next;
    }
}
