namespace Terraport
{
    /// <summary>Takes back the buffers of received messages.</summary>
    public interface ITransportBuffers
    {
        /// <summary>Take a buffer back; called from the thread that took the message.</summary>
        void Return(byte[] buffer);
    }
}
