using System;
using System.IO;
using UnityEditor;
using UnityEditor.AssetImporters;
using UnityEngine;

namespace Lpvbake
{
    /// <summary>Makes a volume of NAME.unity.json and the textures beside it: of .dds it reads the texels
    /// itself; .exr are Unity's to import, with the settings that LpvbakePictures gives it.</summary>
    [ScriptedImporter(1, new string[0], new[] { "json" }, 2000)]
    public class LpvbakeImporter : ScriptedImporter
    {
        public override void OnImportAsset(AssetImportContext ctx)
        {
            string text = File.ReadAllText(ctx.assetPath);
            Notes notes = Notes.Parse(text);
            if (!text.Contains("ShadeSH9"))
            {
                ctx.LogImportError(ctx.assetPath + ": is for another formula; bake without --evaluation");
                return;
            }
            var volume = ScriptableObject.CreateInstance<LpvbakeVolume>();
            volume.min = notes.volume.Min;
            volume.max = notes.volume.Max;
            foreach (string name in notes.textures)
            {
                string suffix = Path.GetFileNameWithoutExtension(name).Substring(notes.StemOf(ctx.assetPath).Length + 1);
                if (suffix != "r" && suffix != "g" && suffix != "b" && suffix != "r2" && suffix != "g2"
                    && suffix != "b2" && suffix != "sh_l2_x2y2")
                    continue;
                string path = Path.Combine(Path.GetDirectoryName(ctx.assetPath), name).Replace('\\', '/');
                Texture3D texture = name.EndsWith(".dds") ? FromDds(ctx, path) : FromPicture(ctx, path);
                if (texture == null)
                    return;
                volume.rowsRunDown = !name.EndsWith(".dds");
                switch (suffix)
                {
                    case "r": volume.r = texture; break;
                    case "g": volume.g = texture; break;
                    case "b": volume.b = texture; break;
                    case "r2": volume.r2 = texture; break;
                    case "g2": volume.g2 = texture; break;
                    case "b2": volume.b2 = texture; break;
                    default: volume.x2y2 = texture; break;
                }
            }
            if (volume.r == null || volume.g == null || volume.b == null)
            {
                ctx.LogImportError(ctx.assetPath + ": names no NAME_r, NAME_g and NAME_b; bake with --target unity "
                                   + "-o NAME.dds or NAME.exr");
                return;
            }
            ctx.AddObjectToAsset("volume", volume);
            ctx.SetMainObject(volume);
        }

        static Texture3D FromDds(AssetImportContext ctx, string path)
        {
            ctx.DependsOnSourceAsset(path);
            if (!File.Exists(path))
            {
                ctx.LogImportError(path + ": is missing; copy all files of the bake");
                return null;
            }
            try
            {
                Texture3D texture = LpvbakeDds.Read(File.ReadAllBytes(path));
                texture.name = Path.GetFileNameWithoutExtension(path);
                ctx.AddObjectToAsset(texture.name, texture);
                return texture;
            }
            catch (FormatException error)
            {
                ctx.LogImportError(path + ": " + error.Message);
                return null;
            }
        }

        static Texture3D FromPicture(AssetImportContext ctx, string path)
        {
            ctx.DependsOnArtifact(path); // imports this again when it is there
            var texture = AssetDatabase.LoadAssetAtPath<Texture3D>(path);
            if (texture == null)
                ctx.LogImportWarning(path + ": is not imported yet, or not as a Texture3D");
            return texture;
        }
    }

    /// <summary>3D textures in half or float, as lpvbake writes them (src/io/README.md).</summary>
    public static class LpvbakeDds
    {
        const int headerBytes = 148;

        /// <summary>Throws FormatException.</summary>
        public static Texture3D Read(byte[] file)
        {
            Func<int, int> word = i => BitConverter.ToInt32(file, 4 * i); // of DDS_HEADER and its extension
            if (file.Length < headerBytes || word(0) != 0x20534444 || word(21) != 0x30315844 || word(33) != 4)
                throw new FormatException("is no 3D texture of lpvbake");
            int height = word(3), width = word(4), depth = word(6), bytes;
            TextureFormat format;
            switch (word(32))
            {
                case 2: format = TextureFormat.RGBAFloat; bytes = 16; break;
                case 10: format = TextureFormat.RGBAHalf; bytes = 8; break;
                default: throw new FormatException("is neither half nor float; bake with --precision half");
            }
            if (width < 1 || height < 1 || depth < 1 || width > 2048 || height > 2048 || depth > 2048
                || (long)width * height * depth * bytes != file.Length - headerBytes)
                throw new FormatException("is cut off; bake it again");
            var texels = new byte[file.Length - headerBytes];
            Array.Copy(file, headerBytes, texels, 0, texels.Length);
            var texture = new Texture3D(width, height, depth, format, false)
            {
                wrapMode = TextureWrapMode.Clamp, filterMode = FilterMode.Bilinear
            };
            texture.SetPixelData(texels, 0);
            texture.Apply(false, true);
            return texture;
        }
    }

    /// <summary>What is read of NAME.unity.json.</summary>
    [Serializable]
    public class Notes
    {
        public string program;
        public string[] textures;
        public Box volume;
        public Settings importer;

        [Serializable]
        public class Box
        {
            public float[] min, max;
            public Vector3 Min { get { return new Vector3(min[0], min[1], min[2]); } }
            public Vector3 Max { get { return new Vector3(max[0], max[1], max[2]); } }
        }

        [Serializable]
        public class Settings
        {
            public int flipbookColumns, flipbookRows;
        }

        public const string Suffix = ".unity.json";

        public static Notes Parse(string text)
        {
            return JsonUtility.FromJson<Notes>(text);
        }

        public string StemOf(string path)
        {
            string name = Path.GetFileName(path);
            return name.Substring(0, name.Length - Suffix.Length);
        }
    }

    /// <summary>Gives NAME.unity.json to LpvbakeImporter, and the pictures that it names their settings.</summary>
    public class LpvbakePictures : AssetPostprocessor
    {
        void OnPreprocessTexture()
        {
            foreach (string json in Directory.GetFiles(Path.GetDirectoryName(assetPath), "*" + Notes.Suffix))
            {
                Notes notes = Notes.Parse(File.ReadAllText(json));
                if (notes.textures == null || Array.IndexOf(notes.textures, Path.GetFileName(assetPath)) < 0
                    || notes.importer == null || notes.importer.flipbookColumns < 1)
                    continue;
                var importer = (TextureImporter)assetImporter;
                var settings = new TextureImporterSettings();
                importer.ReadTextureSettings(settings);
                settings.textureShape = TextureImporterShape.Texture3D;
                settings.flipbookColumns = notes.importer.flipbookColumns;
                settings.flipbookRows = notes.importer.flipbookRows;
                settings.sRGBTexture = false;
                settings.mipmapEnabled = false;
                settings.npotScale = TextureImporterNPOTScale.None;
                settings.wrapMode = TextureWrapMode.Clamp;
                settings.filterMode = FilterMode.Bilinear;
                importer.SetTextureSettings(settings);
                importer.textureCompression = TextureImporterCompression.Uncompressed;
                return;
            }
        }

        static void OnPostprocessAllAssets(string[] imported, string[] deleted, string[] moved, string[] movedFrom)
        {
            foreach (string path in imported)
                if (path.EndsWith(Notes.Suffix) && AssetDatabase.GetImporterOverride(path) == null)
                    AssetDatabase.SetImporterOverride<LpvbakeImporter>(path);
        }
    }
}
