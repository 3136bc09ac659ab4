namespace Terraport
{
    /// <summary>Makes a <see cref="WebSocketTransport"/> for every attempt to connect.</summary>
    public sealed class WebSocketTransportFactory : ITransportFactory
    {
        /// <inheritdoc/>
        public ITransport Create() { return new WebSocketTransport(); }
    }
}
