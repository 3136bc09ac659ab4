namespace Terraport
{
    /// <summary>Name and version of this client, for servers' logs.</summary>
    public static class ClientVersion
    {
        /// <summary>The version of the package (package.json says the same; a test compares them).</summary>
        public const string Number = "0.1.0";

        /// <summary>Name and version as hello sends them.</summary>
        public const string Text = "terraport-unity/" + Number;
    }
}
