namespace Terraport.Unity
{
    /// <summary>The faces of a block of the base that are to be drawn, from all of its faces and the mask of the hidden ones.</summary>
    public static class FaceList
    {
        /// <summary>
        /// Copy the corners of every face that is not hidden, in order. Returns how many indices were written: hidden faces are left
        /// out, not drawn as points.
        /// </summary>
        /// <param name="all">Three indices per face of the block.</param>
        /// <param name="faces">Which faces of the base the block holds.</param>
        /// <param name="hidden">One byte per face of the base, 1 where it is hidden.</param>
        /// <param name="into">At least as long as the block's indices.</param>
        public static int Write(ushort[] all, FaceRange faces, byte[] hidden, ushort[] into)
        {
            int written = 0;
            for (int face = faces.First, from = 0; face < faces.End; face++, from += 3)
            {
                // written never passes from, so even one and the same array would do.
                if (hidden[face] == 0)
                {
                    into[written] = all[from];
                    into[written + 1] = all[from + 1];
                    into[written + 2] = all[from + 2];
                    written += 3;
                }
            }
            return written;
        }
    }
}
