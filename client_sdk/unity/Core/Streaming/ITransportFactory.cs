namespace Terraport
{
    /// <summary>Makes a transport for every attempt to connect.</summary>
    public interface ITransportFactory
    {
        /// <summary>A new transport, not opened; the caller opens and disposes of it.</summary>
        ITransport Create();
    }
}
