namespace Terraport
{
    /// <summary>Where a segment stands between payload and GPU.</summary>
    internal enum SegmentStep
    {
        /// <summary>Nothing is known of it.</summary>
        Unknown,

        /// <summary>The payload is here.</summary>
        Held,

        /// <summary>A decoder has it.</summary>
        Decoding,

        /// <summary>Waits for, or is under, upload.</summary>
        Decoded,

        /// <summary>On the GPU, perhaps still waiting for its texture.</summary>
        Uploaded,

        /// <summary>On the GPU whole: a swap can show it at once.</summary>
        Resident,

        /// <summary>It cannot be decoded or drawn: counts as missing, its base stays.</summary>
        Failed,
    }
}
