namespace Terraport
{
    /// <summary>Makes a transport for every attempt to connect.</summary>
    public interface ITransportFactory
    {
        /// <summary>Make one, not opened.</summary>
        ITransport Create();
    }
}
