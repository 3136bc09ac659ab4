#if UNITY_WEBGL && !UNITY_EDITOR
namespace Terraport.Unity
{
    /// <summary>Makes connections in a browser.</summary>
    public sealed class WebGlTransportFactory : ITransportFactory
    {
        /// <inheritdoc/>
        public ITransport Create() { return new WebGlTransport(); }
    }
}
#endif
