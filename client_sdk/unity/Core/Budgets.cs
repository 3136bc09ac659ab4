namespace Terraport
{
    /// <summary>Hard bounds of every landing, sent with each hello; null does not bound. The server cuts the farthest segments.</summary>
    public sealed class Budgets
    {
        /// <summary>Most triangles shown.</summary>
        public long? MaxTriangles { get; set; }

        /// <summary>Most payload bytes of what is shown, compressed as they travel.</summary>
        public long? MaxBytes { get; set; }

        /// <summary>Most segments shown.</summary>
        public long? MaxSegments { get; set; }
    }
}
