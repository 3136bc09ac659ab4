namespace Terraport
{
    /// <summary>In which form payloads come.</summary>
    public enum PayloadEncoding
    {
        /// <summary>glTF binary with meshopt compression (scene format, section 9): the smallest.</summary>
        Glb,

        /// <summary>Flat arrays (scene format, section 10): three times the bytes, next to no work.</summary>
        Arrays,
    }
}
