namespace Terraport.Json
{
    /// <summary>What a <see cref="JsonValue"/> holds.</summary>
    public enum JsonKind : byte
    {
        /// <summary>Null; also what an absent member reads as.</summary>
        Null,

        /// <summary>True or false.</summary>
        Flag,

        /// <summary>A number written without fraction and exponent that fits into 64 bits.</summary>
        Integer,

        /// <summary>A number written without fraction and exponent beyond 64 bits.</summary>
        HugeInteger,

        /// <summary>A number written with a fraction or an exponent.</summary>
        Float,

        /// <summary>Text.</summary>
        Text,

        /// <summary>An array.</summary>
        List,

        /// <summary>An object.</summary>
        Object,

        /// <summary>Bytes. Text in JSON has none; values read from msgpack may.</summary>
        Binary,
    }
}
