namespace Terraport
{
    /// <summary>Bytes that are not what the scene format says; code "damaged".</summary>
    public sealed class PayloadException : TerraportException
    {
        internal PayloadException(string message) : base("damaged", message) {}
    }
}
