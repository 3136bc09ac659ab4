namespace Terraport.Wire
{
    /// <summary>A message of a type that this version does not know in that direction: skip it.</summary>
    public sealed class UnknownMessage : WireMessage
    {
        private readonly string name;

        internal UnknownMessage(string name) { this.name = name; }

        /// <summary>Its type, at most 64 characters of it.</summary>
        public override string Type => name;

        internal override Field[] Fields => new Field[0];

        internal override object Get(int field) { throw NoField(field); }

        internal override void Set(int field, object value) { throw NoField(field); }
    }
}
