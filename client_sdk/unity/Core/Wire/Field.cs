namespace Terraport.Wire
{
    /// <summary>One field of a table: its name on the wire, and what it holds.</summary>
    internal sealed class Field
    {
        internal Field(string name, bool isRequired, FieldKind kind)
        {
            Name = name;
            IsRequired = isRequired;
            Kind = kind;
        }

        internal string Name { get; }

        internal bool IsRequired { get; }

        internal FieldKind Kind { get; }
    }
}
