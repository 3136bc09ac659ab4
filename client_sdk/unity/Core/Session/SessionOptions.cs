namespace Terraport
{
    /// <summary>Most of what a landing shows: the service leaves the farthest segments out. Null for no bound.</summary>
    public sealed class Budgets
    {
        /// <summary>Triangles.</summary>
        public long? MaxTriangles { get; set; }

        /// <summary>Payload bytes.</summary>
        public long? MaxBytes { get; set; }

        /// <summary>Segments.</summary>
        public long? MaxSegments { get; set; }

        /// <summary>Bytes on the graphics card.</summary>
        public long? MaxGpuBytes { get; set; }

        /// <summary>Bytes that a vertex takes on the graphics card; null for the service's default.</summary>
        public long? GpuVertexBytes { get; set; }

        /// <summary>Bytes that the indices of a face take on the graphics card; null for the service's default.</summary>
        public long? GpuFaceBytes { get; set; }
    }

    /// <summary>Further radii of one landing; null leaves them out.</summary>
    public sealed class LandOptions
    {
        /// <summary>Radius of the smaller set that is shown first where the rest takes longer than <see cref="DeadlineMs"/>, metres.</summary>
        public double? InnerRadiusM { get; set; }

        /// <summary>Milliseconds after which the inner set is shown.</summary>
        public double DeadlineMs { get; set; } = 3000;

        /// <summary>Radius up to which the coarser level is shown, in scenes that have one, metres.</summary>
        public double? CoarseRadiusM { get; set; }
    }

    /// <summary>How a session is opened.</summary>
    internal sealed class SessionOptions
    {
        /// <summary>Name and version of the client, for logs.</summary>
        internal string Client = "terraport-unity";
        internal Budgets Budgets = new Budgets();

        /// <summary>Payload bytes that may be on their way.</summary>
        internal long CreditBytes = 16 << 20;

        /// <summary>Payload bytes kept in memory, besides what a landing needs.</summary>
        internal long CacheBytes = 256 << 20;
    }
}
