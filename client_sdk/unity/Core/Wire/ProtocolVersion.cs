namespace Terraport.Wire
{
    /// <summary>A version of the wire protocol.</summary>
    public readonly struct ProtocolVersion
    {
        /// <summary>A version of two numbers, each 0 to 65535; checked when it is sent.</summary>
        public ProtocolVersion(int major, int minor)
        {
            Major = major;
            Minor = minor;
        }

        /// <summary>Another major version is another protocol.</summary>
        public int Major { get; }

        /// <summary>A newer minor version adds to an older one.</summary>
        public int Minor { get; }

        /// <summary>Major and minor with a dot.</summary>
        public override string ToString() { return Major + "." + Minor; }
    }
}
