namespace Terraport.Wire
{
    /// <summary>A message of the wire protocol (section 13).</summary>
    public abstract class WireMessage : WirePart
    {
        /// <summary>Its type on the wire.</summary>
        public abstract string Type { get; }
    }
}
