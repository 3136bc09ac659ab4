namespace Terraport.Wire
{
    /// <summary>Bytes or an order of messages that the protocol does not allow; code "malformed".</summary>
    public sealed class WireException : TerraportException
    {
        internal WireException(string message) : base("malformed", message) {}
    }
}
