namespace Terraport
{
    /// <summary>Consecutive faces of a mesh.</summary>
    public readonly struct FaceRange
    {
        /// <summary>Number of the first face.</summary>
        public readonly int First;

        /// <summary>Number of faces.</summary>
        public readonly int Count;

        /// <summary>Consecutive faces from <paramref name="first"/> on.</summary>
        public FaceRange(int first, int count)
        {
            First = first;
            Count = count;
        }

        /// <summary>Number of the face after the last.</summary>
        public int End => First + Count;
    }
}
