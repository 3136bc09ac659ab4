namespace Terraport.Json
{
    /// <summary>What a <see cref="JsonNode"/> is.</summary>
    internal enum JsonNodeKind : byte
    {
        Null,
        False,
        True,
        Number,
        Text,
        List,
        Object,
    }
}
