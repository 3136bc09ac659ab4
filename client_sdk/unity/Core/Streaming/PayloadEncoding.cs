namespace Terraport
{
    /// <summary>The bytes that segments come in (scene format, sections 9 and 10).</summary>
    public enum PayloadEncoding
    {
        /// <summary>glTF-binary with meshopt compression: the smaller one.</summary>
        Glb,

        /// <summary>Plain arrays: larger on the way, next to nothing to decode.</summary>
        Arrays,
    }
}
