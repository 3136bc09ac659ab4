namespace Terraport
{
    /// <summary>One scene that a server shows.</summary>
    public sealed class SceneSummary
    {
        internal SceneSummary(string id, string name, string version, string url)
        {
            Id = id;
            Name = name;
            Version = version;
            Url = url;
        }

        /// <summary>Scene id.</summary>
        public string Id { get; private set; }

        /// <summary>Name for people; the id where the server gives none.</summary>
        public string Name { get; private set; }

        /// <summary>The published version.</summary>
        public string Version { get; private set; }

        /// <summary>Address of the scene.</summary>
        public string Url { get; private set; }
    }
}
