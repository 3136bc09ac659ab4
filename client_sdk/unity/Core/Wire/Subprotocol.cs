namespace Terraport.Wire
{
    /// <summary>How messages are written; payload frames are the same in both.</summary>
    public enum Subprotocol
    {
        /// <summary>terraport.v1.msgpack: binary messages.</summary>
        Msgpack,

        /// <summary>terraport.v1.json: text messages.</summary>
        Json,
    }
}
