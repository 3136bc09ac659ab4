namespace Terraport
{
    /// <summary>Owner of the buffers that received messages lie in; each is returned once.</summary>
    public interface ITransportBuffers
    {
        /// <summary>Take a buffer back; called from the thread that took the message.</summary>
        void Return(byte[] buffer);
    }
}
