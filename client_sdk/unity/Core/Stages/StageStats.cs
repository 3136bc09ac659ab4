namespace Terraport
{
    /// <summary>What a stage holds and does.</summary>
    public struct StageStats
    {
        /// <summary>Segments on the GPU, or under upload.</summary>
        public int UploadedSegments;

        /// <summary>Segments shown.</summary>
        public int VisibleSegments;

        /// <summary>Segments being decoded, or decoded and not uploaded.</summary>
        public int InFlight;

        /// <summary>GPU bytes of segments that nobody shows or waits for.</summary>
        public long SpareGpuBytes;

        /// <summary>Milliseconds that the last Update took.</summary>
        public double UpdateMs;

        /// <summary>Longest Update since the stage was made, milliseconds.</summary>
        public double UpdateMaxMs;
    }
}
