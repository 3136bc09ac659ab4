namespace Terraport.Wire
{
    /// <summary>A message of the wire protocol (section 13).</summary>
    public abstract class WireMessage : WirePart
    {
        /// <summary>Its type on the wire, the value of the key "type".</summary>
        public abstract string Type { get; }
    }
}
